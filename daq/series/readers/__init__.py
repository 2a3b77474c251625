"""Readers of decoded series, a file a format; `daq.series.formats` chooses among them."""
