"""What every stage of training runs on: the loop, checkpoints, batches of rays, the optimiser, ranks.

What a stage learns is beside it: ``base``, ``palette``, ``paint``, ``match``.
"""
