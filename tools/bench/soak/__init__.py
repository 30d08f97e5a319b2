"""Whether a robot and its controller run unattended for hours: what they keep, and what grows."""
