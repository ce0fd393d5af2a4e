"""The program around it all: configuration, command line, and how the parts are put together.

Start reading at `assembly`.
"""
