#!/usr/bin/env python3
"""Fails if a test of a build directory has a name of more than 60 characters, or more than 50 after
the suite's name. Usage: test_names.py BUILD"""

import re
import subprocess
import sys

listing = subprocess.run(["ctest", "--test-dir", sys.argv[1], "-N"],
                         capture_output=True, text=True, check=True).stdout
names = [name.split("  # ")[0] for name in re.findall(r"Test +#\d+: (.*)", listing)]
long = [name for name in names if len(name) > 60 or len(name.rsplit(".", 1)[-1]) > 50]
print("\n".join(f"{name}: too long" for name in long) or f"{len(names)} names are short enough")
sys.exit(1 if long or not names else 0)
