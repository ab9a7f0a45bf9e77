"""The whole job, from a volume or views to a page of results, in stages that are not repeated."""
