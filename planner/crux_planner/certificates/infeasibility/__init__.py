"""Proofs that a climb has no plan: relaxations of P1 that every plan satisfies, shown to have no solution."""
