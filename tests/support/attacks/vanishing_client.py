"""A client that is killed: holds its token and waits.   vanishing_client.py ENDPOINT ROBOT WHO"""

from __future__ import annotations

import sys

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_link import ZenohControllerLink

endpoint, robot, who = sys.argv[1:]
link = ZenohControllerLink(robot, LinkSettings(connect=(endpoint,)), who)
link.presence.wait()
print("ready", flush=True)
sys.stdin.read()
