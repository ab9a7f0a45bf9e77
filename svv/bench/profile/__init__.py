"""Where the seconds of training go, beside what the machine could do at best."""
