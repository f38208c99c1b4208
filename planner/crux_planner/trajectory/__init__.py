"""Body motion and forces with the contacts fixed: QPs about a motion, the exact NLPs, and plans without their waits."""
