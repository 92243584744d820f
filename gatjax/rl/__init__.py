"""Reinforcement learning in the walk world: a Brax environment, and Brax's PPO."""
