"""Attacks on the commands: killed, robbed of their disk and short of memory."""
