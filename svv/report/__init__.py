"""The whole job, from a volume to a stylized orbit, and the page that shows it."""
