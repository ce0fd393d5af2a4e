"""The live view: a server beside the camera's driver, and the page that a browser gets from it.

Disparity goes to the browser, whose graphics card makes points of it; nothing is loaded from any other host.
"""
