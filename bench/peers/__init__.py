"""pyinfra and Ansible, the tools that operators would use instead of Lupin: installing, configuring and running them."""
