"""The learner: networks, advantages, the clipped update."""
