"""What `raybench verify` does: options, worker processes, printed results."""
