"""Campaigns against files, commands and ParaView; short forms run as tests, long ones by command."""
