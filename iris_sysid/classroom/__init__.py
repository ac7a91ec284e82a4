"""One experiment by many groups: each group's value, what is wrong with those that stand out, and the value of all."""
