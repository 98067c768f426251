"""What ``motion-style info`` shows of an effort library."""

__all__ = ['describe']


def describe(header, arrays):
    """Fragments, contents and labels."""
    groups = arrays['groups']
    contents = {f'content {group}': [name for name, g in zip(header['fragment_names'], groups) if g == group]
                for group in range(int(groups.max()) + 1)}
    efforts = {name: [round(float(value), 2) for value in row]
               for name, row in zip(header['fragment_names'], arrays['efforts'])}
    return {'fragments': len(groups), 'interpolations': len(arrays['blend_alphas']), 'labels': header['labeller'],
            'method': header['method'], 'content threshold': header['threshold'], **contents,
            'flow, weight, time': efforts}
