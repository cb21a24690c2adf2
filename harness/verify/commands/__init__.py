"""What `raybench verify` and `raybench equivalence` do: options, worker processes, printed results."""
