"""What files leave open (orders, units, axes), and what gives a wrong reading away."""
