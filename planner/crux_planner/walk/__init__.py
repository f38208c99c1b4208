"""Walking on point feet: footholds anywhere on the surface, Coulomb friction of the wall, no grasps."""
