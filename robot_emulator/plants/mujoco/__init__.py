"""A body in MuJoCo: contacts, servos that give way, a base that may fall; the extra `[mujoco]`.

`settings` is what a config says, `rerooted_urdf` puts another link of a URDF to its root, `model`
makes MuJoCo's model, `equilibrium` finds the start at rest, `senses` fills the arrays of State,
`balance` watches soles and centre of mass, `plant` puts it all together.
"""
