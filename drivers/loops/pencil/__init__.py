"""The pencil balancer, after Conradt et al., ISCAS 2009. See drivers/loops/README.md."""
