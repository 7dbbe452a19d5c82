"""The lengths of physics steps and control steps, whichever robot is simulated."""

SIM_DT_S = 0.005
DECIMATION = 4  # physics steps in a control step
CONTROL_DT_S = SIM_DT_S * DECIMATION
