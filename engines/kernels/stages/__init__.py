"""Stages: each loads from the ray batch and the scene, calls functions of one lane, and stores what they return."""
