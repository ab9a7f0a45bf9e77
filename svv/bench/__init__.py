"""What measures the rest of the package; nothing else imports it."""
