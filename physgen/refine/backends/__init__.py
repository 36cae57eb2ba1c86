"""Video diffusion models, one file each; what each takes and gives is `refine.roles.Denoiser`."""
