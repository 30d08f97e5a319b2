"""The user's own files of robots in MuJoCo's format."""
