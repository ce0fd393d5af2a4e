"""What a host can set, ask and have done: settings, commands, stills, self-test.

Start reading at `settings`, then `command_table`.
"""
