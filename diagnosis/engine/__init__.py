"""The method: noise, fits, scores, gates, verdicts. It works for any simulator with the interface
`diagnosis.contracts`.
"""
