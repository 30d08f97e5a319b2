"""Commands that show a robot or a log to people and to other programs: `view`, `bridge`."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hoap3.tools.analysis.output import print_line, print_note, print_result
from hoap3.tools.cli.options import AsJson, Connect, Running, Secure, reached
from hoap3.tools.machine.processes import StopFlag, to_people

if TYPE_CHECKING:
    from hoap3.tools.bridge.robot_feed import Viewer


def view(
    what: Annotated[
        str | None,
        typer.Argument(
            metavar="[ROBOT|LOG]",
            help="Name of a running robot, or a log or the folder of a run. Default: the only "
            "robot that runs.",
        ),
    ] = None,
    second: Annotated[
        Path | None, typer.Argument(metavar="[LOG]", help="A second log, drawn as a ghost.")
    ] = None,
    connect: Connect = None,
    secure: Secure = None,
    host: Annotated[
        str,
        typer.Option("--host", help="Address to listen on; beyond loopback others can connect."),
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Port to listen on; 0: any free one.")
    ] = 8080,
    robot: Annotated[
        str | None,
        typer.Option("--robot", help="Folder of the robot on this machine, to draw its meshes."),
    ] = None,
    no_steering: Annotated[
        bool, typer.Option("--no-steering", help="Read only: pages cannot stop, change or steer.")
    ] = False,
) -> None:
    """Show a running robot, or a log, in a browser; print the address of the page."""
    from hoap3.tools.machine.machine import check_extra

    check_extra("view")
    from hoap3.tools.view.serve import serve_log, serve_robot, warn_of

    logs = [Path(what)] if what is not None and is_log(what) else []
    note = warn_of(host)
    if note:
        print_note(note)
    if logs:
        serve_log([*logs, *([second] if second else [])], host, port, robot, _show_address)
        return
    if second is not None:
        raise typer.BadParameter("a second log goes with a log, not with a robot")
    from hoap3.tools.services.find_robot import reach_robot

    name, endpoint = reach_robot(what, reached(connect, secure))
    serve_robot(
        *(name, endpoint, host, port, robot, _show_address),
        steering=not no_steering,
    )


def _show_address(address: str) -> None:
    print_line(address)
    print_note("press Ctrl+C to end the page; a robot that runs is not affected")


def is_log(what: str) -> bool:
    """Whether it names a log rather than a robot."""
    path = Path(what)
    return "/" in what or path.suffix == ".mcap" or any(path.glob("*.mcap"))


bridge_app = typer.Typer(
    no_args_is_help=True, help="Show a running robot in Foxglove, PlotJuggler or ROS 2."
)


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
            help="Accept points and poses of Foxglove panels as live targets. Anyone who reaches "
            "the port can then steer, also web pages in a browser on this machine.",
        ),
    ] = False,
) -> None:
    """Serve a robot's messages, model and frames to Foxglove, until SIGINT or SIGTERM."""
    stop = StopFlag()
    from hoap3.tools.bridge.foxglove_server import FoxgloveServer

    with closing(FoxgloveServer(host, port, steer=steer, report=to_people)) as server:
        to_people(f"Foxglove: open ws://{host}:{server.port}")
        if steer:
            to_people("whoever reaches that port may steer, web pages of a browser here among them")
        _show(robot, reached(connect, secure), server, stop)


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
    namespace: Annotated[
        str, typer.Option(help="Namespace of node and topics, such as /robot1.")
    ] = "",
) -> None:
    """Publish joint states and the robot's description to ROS 2 over rmw_zenoh."""
    stop = StopFlag()
    from hoap3.tools.bridge.ros2_publisher import Ros2Publisher

    with closing(Ros2Publisher(listen, router, domain, namespace)) as publisher:
        to_people(f"ROS 2: domain {domain}, {f'router {router}' if router else listen}")
        _show(robot, reached(connect, secure), publisher, stop)


@bridge_app.command()
def layouts(
    robot: Annotated[str, typer.Option(help="Robot: a name or a path.")] = "hoap3",
    out: Annotated[Path, typer.Option("--out", help="Folder for the layouts.")] = Path("layouts"),
    as_json: AsJson = False,
) -> None:
    """Write layouts for Foxglove and PlotJuggler, for logs and running robots."""
    from hoap3.tools.bridge.layouts import write_layouts

    written = write_layouts(robot, out)
    names = [str(path) for path in written]
    print_result({"layouts": names}, names, as_json=as_json)


def _show(robot: str | None, connect: str | None, viewer: Viewer, stop: StopFlag) -> None:
    from hoap3.tools.bridge.robot_feed import feed
    from hoap3.tools.services.find_robot import reach_robot

    feed(lambda: reach_robot(robot, connect), viewer, stop, to_people)
