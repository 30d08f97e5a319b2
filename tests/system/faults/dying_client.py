"""A client that asks for authority and is killed.   dying_client.py ENDPOINT ROBOT WHO early|late

Its token is there early, or is declared late: just before it asks. Told to go on, it asks, waits
for no answer, and says so.
"""

from __future__ import annotations

import sys
import time

import zenoh

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_session import key, open_session

ON_ITS_WAY_S = 0.01  # until the request has certainly left this process

endpoint, robot, who, when = sys.argv[1:]
name = key(robot, f"clients/{who}")
session = open_session(LinkSettings(connect=(endpoint,), mode="client"))
token = session.liveliness().declare_token(name) if when == "early" else None
print("ready", flush=True)
sys.stdin.readline()
token = token or session.liveliness().declare_token(name)
answers = session.get(key(robot, f"ask/acquire/{who}"), zenoh.handlers.FifoChannel(1))
time.sleep(ON_ITS_WAY_S)
print("asked", flush=True)
sys.stdin.read()
