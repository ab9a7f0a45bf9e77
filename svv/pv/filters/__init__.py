"""The filters, readers and the writer: what happens on *Apply*, and how results are kept."""
