"""Write pace.pt with PyTorch; 2.15 wrote the file that is here."""

import torch

time = torch.linspace(0.0, 1.0, 51, dtype=torch.float64)
both = torch.stack([torch.sin(time), torch.cos(time), -time], 1).float()
tensors = {"time": time, "dof_pos": both[:, :2], "des_dof_pos": 2.0 * both[:, 1:]}
torch.save(tensors, "pace.pt")
