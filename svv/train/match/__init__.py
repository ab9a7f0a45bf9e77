"""Stage 3 as in the paper: the unrestricted colour network (UCN) is distilled and matched to features of VGG-16."""
