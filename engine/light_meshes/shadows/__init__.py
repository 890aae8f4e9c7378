"""Shadows: how much of each light a receiver sees. There is one contract for all methods, and a file for each
method.
"""
