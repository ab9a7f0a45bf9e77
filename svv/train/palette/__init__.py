"""Stage 2: regions, their colours and the palette colour network (PCN)."""
