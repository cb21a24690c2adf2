"""The harness: configs to cells, cells to timed renders, renders to metrics, tables, plots and a report."""
