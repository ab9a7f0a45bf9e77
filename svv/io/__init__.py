"""Reading and writing of files: view sets, scene files and images."""
