"""The tools that operators would use otherwise, pyinfra and Ansible: how they are installed, set up and told what to do."""
