"""Stage 3 as it is by default: brush strokes, ink and pieces of pictures, laid on the regions' visible surfaces."""
