"""OpenSCENARIO storyboards on OpenDRIVE roads."""
