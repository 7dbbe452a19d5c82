"""How time passes in a simulation, whichever robot is in it: physics steps and control steps."""

SIM_DT_S = 0.005
DECIMATION = 4  # physics steps in a control step
CONTROL_DT_S = SIM_DT_S * DECIMATION
