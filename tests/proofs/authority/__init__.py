"""Who may command the robot: every state that the product's own steps can lead to."""
