"""Plans: from an experiment to cells, the references they need and the verify jobs beside them, before anything runs."""
