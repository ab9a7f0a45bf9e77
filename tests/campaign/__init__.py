"""Campaigns: what is read is attacked with generated inputs; short forms run as tests, long ones by command."""
