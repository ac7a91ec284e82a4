"""What a governing equation may lack, one effect a file."""
