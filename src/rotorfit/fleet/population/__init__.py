"""What many estimates say together: their common mean, what changed, what stands out."""
