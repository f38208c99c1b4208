"""The paper's distributed methods: two-block and multi-block ADMM, and the benchmark NLP; equations in problem terms.

`admm` is the loop (17), (19); `contact_block` P2a, `motion_block` P2b, `limb_block` a limb's MIP of P3; `hull` the MILP
behind the contact decisions, `bound` what it proves, `benchmark` P1 as one NLP.
"""
