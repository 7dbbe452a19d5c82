"""The two layers of the reward, and what the lower one is judged by."""
