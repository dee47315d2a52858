SELECT material, completion FROM completions WHERE material = ANY ($1)
