"""Controllers of accelerations and torques: ghc, hqp, weighted, tsid, joint_acceleration."""
