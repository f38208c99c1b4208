"""What limbs reach, as maps: of single gripper poses, of boxes of them, and of body poses on a grid."""
