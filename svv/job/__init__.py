"""The whole job, from a volume or views to a page of results; and other ways in that train: looks, words, PyVista."""
