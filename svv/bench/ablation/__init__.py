"""What each part is worth: stages made again with one part left out."""
