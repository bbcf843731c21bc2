"""What an orbit comes near to, how near with what sigma, and whether it may hit."""
