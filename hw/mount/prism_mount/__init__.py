"""The printable mount of a prism rig, drawn from the rig's own file: `layout` decides, the other modules cut material."""
