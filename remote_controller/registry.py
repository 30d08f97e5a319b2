"""Controllers by name: ours, those of installed packages, and the user's own by dotted path."""

from __future__ import annotations

from hoap3.protocol.config.plugins import PluginGroup

GROUP = "hoap3.controllers"
BUILTIN = {
    "qp12": "hoap3.remote_controller.controllers.qp12.qp12:Qp12Controller",
    "pinv": "hoap3.remote_controller.controllers.qp12.qp12:PinvController",
    "stable_qp": "hoap3.remote_controller.controllers.lyapunov_qp.stable_qp:StableQpController",
    "osqp": "hoap3.remote_controller.controllers.qp12.qp12:OsqpController",
    "joint_acceleration": (
        "hoap3.remote_controller.controllers.acceleration.joint_acceleration:JointAccelerationController"
    ),
    "tsid": "hoap3.remote_controller.controllers.acceleration.tsid:TsidController",
    "ghc": "hoap3.remote_controller.controllers.acceleration.ghc:GhcController",
    "ghc_torque": (
        "hoap3.remote_controller.controllers.acceleration.ghc_torque:GhcTorqueController"
    ),
    "hqp": "hoap3.remote_controller.controllers.acceleration.hqp:HqpController",
    "weighted": "hoap3.remote_controller.controllers.acceleration.weighted:WeightedController",
    "ghc_velocity": (
        "hoap3.remote_controller.controllers.velocity.ghc_velocity:GhcVelocityController"
    ),
    "clik": "hoap3.remote_controller.controllers.velocity.clik:ClikController",
    "clik_sdp": "hoap3.remote_controller.controllers.velocity.clik:ClikSdpController",
}
CONTROLLERS = PluginGroup(
    "controller",
    GROUP,
    BUILTIN,
    ("hoap3.remote_controller.controllers.base:Controller",),
    "extending",
)
registered, find = CONTROLLERS.registered, CONTROLLERS.find


def of_constraints() -> list[str]:
    """Ours that take `constraints`."""
    return [name for name in BUILTIN if "constraints" in find(name).Parameters.model_fields]
