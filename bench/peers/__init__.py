"""The programs that Lupin is compared with: pyinfra and Ansible, which operators would use instead, and rosbridge_suite."""
