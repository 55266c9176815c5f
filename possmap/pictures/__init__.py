"""Pictures of a grid: what each cell becomes, what stands around it, and how it is written."""
