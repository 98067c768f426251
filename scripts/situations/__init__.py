"""Machines and habits that differ from ours, simulated: ``make test-setup`` runs every one and prints a table.

A situation is a function that prepares something, runs a command as a user would, and asserts on what came out.
"""
