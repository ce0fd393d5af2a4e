"""Semi-global matching in tiles of 32x32 pixels: over a short list of labels per tile, or over all of them.

Read in this order: `values` and `lanes` (vectors of bytes for numba), `census_kernels` (what a pixel looks like),
`step_kernels`, `path_kernels` and `sweep_kernels` (costs summed along rows and columns), `winner_kernels` (the best label
of a pixel), `label_kernels` (which labels a tile tries), `level` (all of that at one resolution), `pyramid` (levels from
coarse to fine), `tiles` and `semiglobal` (the matchers).
"""
