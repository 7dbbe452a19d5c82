"""What a robot is, and the MuJoCo model made from it."""
