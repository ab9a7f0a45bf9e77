"""What every stage of training runs on: settings, the loop, checkpoints, batches of rays, ranks, reports.

What a stage learns is beside it: ``base``, ``palette``, ``paint``, ``match``.
"""
