"""HTTPS for the console: a certificate authority of this user's own, and the server's certificate that it issues."""

from lupin_runtime.console.certificate.server_certificate import ServerCertificate
from lupin_runtime.console.certificate.store import CertificateError, Certificates, CertificateStore

__all__ = ["CertificateError", "CertificateStore", "Certificates", "ServerCertificate"]
