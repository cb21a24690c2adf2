"""BSDFs: sample, evaluate and pdf of each model. One module a model; `interface` has their signatures."""
