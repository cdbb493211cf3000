"""Checks that contradict a fit or a declaration: findings, and nothing changes."""
