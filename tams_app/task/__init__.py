"""The pick-and-place task: who judges a trial, and what people mark in one."""
