"""The service: frames, pictures, answers and heartbeats of one camera on one link, to whichever host says hello.

Start reading at `service`.
"""
