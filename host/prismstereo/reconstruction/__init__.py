"""From depth to geometry: metric surfaces with their uncertainty, meshes cut at depth edges, sequences of them."""

from prismstereo.reconstruction.gates import Gates
from prismstereo.reconstruction.holes import fill_small_holes
from prismstereo.reconstruction.mesh import Mesh, mesh_of
from prismstereo.reconstruction.steady import Steady
from prismstereo.reconstruction.surface import Surface

__all__ = ["Gates", "Mesh", "Steady", "Surface", "fill_small_holes", "mesh_of"]
