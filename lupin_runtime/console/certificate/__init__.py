"""HTTPS for the console: this user's own certificate authority, and the server certificate that it issues."""

from lupin_runtime.console.certificate.server_certificate import ServerCertificate
from lupin_runtime.console.certificate.store import CertificateError, Certificates, CertificateStore

__all__ = ["CertificateError", "CertificateStore", "Certificates", "ServerCertificate"]
