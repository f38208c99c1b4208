"""The paper's distributed methods, and P1 as one relaxed NLP.

`admm` has the loops (19) and P3; `contact_block` is P2a by the MIP of `hull` on `windows`, for walks by `walk_mip`;
`motion_block` is P2b; `limbs` has the blocks of P3, `turns` what they know of one another.
"""
