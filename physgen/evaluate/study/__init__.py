"""People's eyes as a measure: a blind page of clips to rate, and what their answers say."""
