"""The live page: what a robot does, in a browser, from its messages or its log.

It runs in a process of its own and listens as any client does; nothing of it is in a loop.
"""
