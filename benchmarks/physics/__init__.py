"""Physics beside other engines, and its table."""
