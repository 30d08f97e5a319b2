"""The commands `hoap3 bridge …`: a running robot in other people's viewers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hoap3.tools.cli.options import AsJson, Connect, Secure, reached
from hoap3.tools.machine.processes import StopFlag, to_people
from hoap3.tools.show.output import print_json, print_line

if TYPE_CHECKING:
    from hoap3.tools.bridge.robot_feed import Viewer

bridge_app = typer.Typer(
    no_args_is_help=True, help="Show a running robot in Foxglove, PlotJuggler or ROS 2."
)
Running = Annotated[
    str | None, typer.Argument(help="Name of the robot. Default: the only one that runs.")
]


@bridge_app.command()
def foxglove(
    robot: Running = None,
    connect: Connect = None,
    secure: Secure = None,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65_535, help="Port to listen on; 0: any that is free.")
    ] = 8765,
    steer: Annotated[
        bool,
        typer.Option(
            "--steer",
            help="Take points and poses that its panels publish as live targets. Whoever reaches "
            "the port may then steer, web pages in a browser of this machine among them.",
        ),
    ] = False,
) -> None:
    """Serve a robot's messages, model and frames to Foxglove, until SIGINT or SIGTERM."""
    stop = StopFlag()
    from hoap3.tools.bridge.foxglove_server import FoxgloveServer

    server = FoxgloveServer(host, port, steer=steer, report=to_people)
    try:
        to_people(f"Foxglove: open ws://{host}:{server.port}")
        if steer:
            to_people("whoever reaches that port may steer, web pages of a browser here among them")
        _show(robot, reached(connect, secure), server, stop)
    finally:
        server.close()


@bridge_app.command()
def ros2(
    robot: Running = None,
    connect: Connect = None,
    secure: Secure = None,
    listen: Annotated[
        str, typer.Option(help="Endpoint on which ROS 2 nodes and routers find the bridge.")
    ] = "tcp/127.0.0.1:7448",
    router: Annotated[
        str | None,
        typer.Option(help="Endpoint of a ROS 2 router to connect to, instead of listening."),
    ] = None,
    domain: Annotated[int, typer.Option(min=0, max=232, help="ROS_DOMAIN_ID.")] = 0,
    namespace: Annotated[str, typer.Option(help="Of the node and its topics: /robot1.")] = "",
) -> None:
    """Publish joint states and the robot's description to ROS 2 over rmw_zenoh."""
    stop = StopFlag()
    from hoap3.tools.bridge.ros2_publisher import Ros2Publisher

    publisher = Ros2Publisher(listen, router, domain, namespace)
    try:
        to_people(f"ROS 2: domain {domain}, {f'router {router}' if router else listen}")
        _show(robot, reached(connect, secure), publisher, stop)
    finally:
        publisher.close()


@bridge_app.command()
def layouts(
    robot: Annotated[str, typer.Option(help="Robot: a name or a path.")] = "hoap3",
    out: Annotated[Path, typer.Option("--out", help="Folder to write them into.")] = Path(
        "layouts"
    ),
    as_json: AsJson = False,
) -> None:
    """Write layouts for Foxglove and PlotJuggler, for a log as for a running robot."""
    from hoap3.tools.bridge.layouts import write_layouts

    written = write_layouts(robot, out)
    if as_json:
        print_json({"layouts": [str(path) for path in written]})
    else:
        print_line("\n".join(map(str, written)))


def _show(robot: str | None, connect: str | None, viewer: Viewer, stop: StopFlag) -> None:
    from hoap3.tools.bridge.robot_feed import feed
    from hoap3.tools.services.find_robot import reach_robot

    feed(lambda: reach_robot(robot, connect), viewer, stop, to_people)
