"""From keyframes to a clip by inverse kinematics."""
