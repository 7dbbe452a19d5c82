"""Pictures and videos of saved states, drawn off screen."""
