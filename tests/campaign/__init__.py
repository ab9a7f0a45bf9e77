"""Campaigns that attack the project at length; short forms of them are ordinary tests."""
