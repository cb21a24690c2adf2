"""Plans: from an experiment to cells, the references they need and the verify jobs beside them, before anything runs.

- A *combination* is one value of every setting, as the experiment file writes it (`config.settings.Combination`).
- A *configuration* is a combination whose scene is loaded and whose choices have all their options; its digest is an id.
- A *cell* is a configuration in one block, under that block's seed: what is measured at once (`plan.cells.Cell`).
- A *contestant* is a configuration with all of its measured cells (`store.results.Contestant`): what reports compare.
"""
