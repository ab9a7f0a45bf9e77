"""Files in and out: view sets, scene files and images."""
