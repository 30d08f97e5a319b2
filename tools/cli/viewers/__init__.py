"""Commands that show a robot to people and to the programs of others."""
