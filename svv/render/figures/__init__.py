"""Figures of scenes for papers: panels with a legend of painted swatches, a scale bar; whether colours differ."""
