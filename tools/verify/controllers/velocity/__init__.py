"""Controllers of joint velocities with several tasks: `clik`, `clik_sdp`, `ghc_velocity`."""
