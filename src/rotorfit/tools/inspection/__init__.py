"""Inspect one log, without an airframe and before any fit."""
