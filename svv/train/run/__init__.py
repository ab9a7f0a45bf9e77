"""What every stage of training runs on: settings, the loop, checkpoints, batches of rays, ranks, reports."""
