"""The link on the bench: a line that goes wrong on purpose, frames that are known at both ends, and what came of them."""
