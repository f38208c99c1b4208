"""The paper's distributed methods, and P1 as one relaxed NLP.

`admm` has the loops (19) and P3; `contact_block` is P2a of a climb by the MIP of `hull` on `windows`, `walk_block` that
of a walk by `walk_mip`; `motion_block` is P2b; `climb_limbs` and `walk_limbs` are the limbs' blocks of P3.
"""
