"""Records of runs, or runs made now -> what each stage takes, beside the paper's table and on a named machine."""
