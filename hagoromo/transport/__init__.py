"""Light transport through volume boxes on the device: the march (MODEL §3), its lighting and its shadows."""
