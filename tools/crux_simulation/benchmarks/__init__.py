"""`crux bench`: figures of merit that anyone can reproduce with one command."""
