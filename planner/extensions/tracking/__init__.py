"""Tracking: tensions for a moving target, in bounded time per step."""
